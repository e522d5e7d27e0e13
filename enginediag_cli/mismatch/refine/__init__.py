"""The model with what it lacked, judged on flights that were not used."""
