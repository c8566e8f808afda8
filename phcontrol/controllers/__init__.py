"""The laws, one file each, on one contract."""
