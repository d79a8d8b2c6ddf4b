"""Stands for the package that had Plasma until its version 11."""
