"""Methods of diagnosis behind one interface: what a study compares and `detect --method` offers."""
