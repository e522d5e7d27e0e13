"""Trials with known truth: Monte-Carlo studies of diagnosis, and blind trials of `explain` and `isolate`.

A trial draws an engine, conceals something, records flights, asks the diagnosing process about them, and marks its
answer. The package reads engine files and study files, and gives counts and rates with intervals. Only the commands
`study`, `prove` and `demo` import it.

Open `trials` first: it is the harness of every trial. `kinds` lists what is concealed and how often, `explain_trials`
and `isolation_trials` run one trial each, `marks` compares an answer with the truth, `score_sheet` counts the marks.
`studies` repeats the experiment of a study file, `demonstration` plays `enginediag demo`.
"""
