"""What a transfer study found, as sections of the report."""
