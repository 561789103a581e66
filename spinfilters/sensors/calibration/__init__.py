"""Consider parameters of sensors' calibrations, a file each."""
