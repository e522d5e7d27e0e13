"""The command line: one thin function per command, which reads options, calls the library once and writes the result.

Open `main.py` first for the list of commands, then `options.py`, where every shared option is declared once. The
modules `model`, `diagnosis`, `over_time`, `discrepancy`, `files` and `validation` hold the commands by topic;
`config.py` is what all of them do besides their own work. Commands import `enginediag_cli.api` and
`enginediag_cli.report`, nothing deeper.
"""
