"""Pictures, films and pages of membranes and runs."""
