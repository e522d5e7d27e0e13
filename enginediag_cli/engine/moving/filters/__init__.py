"""Filters along the time of a record, one file each: values and exact derivatives, no loop over records."""
