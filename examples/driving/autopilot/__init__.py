"""What the federates of the example do, apart from HPRM: simulate, drive, detect, decide."""
