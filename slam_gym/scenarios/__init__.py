"""Named presets, one TOML file each."""
