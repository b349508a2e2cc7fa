"""Studies as one file each, and whether such a file is what it says."""
