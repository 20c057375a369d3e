"""The commands of `slam-gym`: each module holds one dataclass whose fields are its options."""
