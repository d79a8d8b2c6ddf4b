"""What one process can do without another: a class for each way."""
