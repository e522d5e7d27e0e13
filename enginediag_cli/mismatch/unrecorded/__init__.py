"""Effects whose driver no column records: amplitudes record by record, states and switch times."""
