"""One posterior for what the model lacks: under construction beside `mismatch`, which it will replace.

A problem that is linear in everything that may be wrong (`linearised`), noise whose size and correlation are estimated
anew under every hypothesis (`noise`), candidates of several kinds at every place (`candidates`), one search (`search`),
one posterior and answer (`explain`). Open `explain` first. The trials with effects that are
put into real recordings (`validation.injected`) use it.
"""
