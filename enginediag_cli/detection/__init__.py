"""Detection: has anything changed, how sure is that, and how small a change would have been seen."""
