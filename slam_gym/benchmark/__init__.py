"""How fast it is, against what people use today, all in one process: `slam-gym benchmark`."""
