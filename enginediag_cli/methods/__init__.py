"""Methods of diagnosis behind one interface: what a study compares and `detect --method` offers.

A method is trained once on an engine and its healthy windows, and then judges any number of windows of records
together: it gives `Verdicts`, with the tests, the alarms and the parameters that it names.

Open first: `base` (the interface, and windows of records), `registry` (every method by its name), then one method:
`residual_tests` (parity equations, principal components), `filters` (Kalman filters), `estimation` (re-estimation).
"""
