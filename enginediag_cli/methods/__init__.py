"""Methods of diagnosis behind one interface, one per file: what a study compares and `detect --method` offers."""
