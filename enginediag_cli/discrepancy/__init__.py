"""One posterior for what the model lacks: under construction beside `mismatch`, which it will replace.

A problem that is linear in everything that may be wrong (`linearised`), noise whose size and correlation are estimated
anew under every hypothesis (`noise`), candidates of several kinds at every place (`candidates`), one search (`search`),
refits of the leaders (`explain`), one posterior and answer (`answer`). Open `explain`
first. The trials with effects that are put into real recordings (`validation.injected`) use it.
"""
