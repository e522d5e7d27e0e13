"""Simulation of engines that move: shaft speeds and other states of the network, integrated along time.

`moving_engine.MovingEngine` is the entry. `states` says which states an engine has, `integrate` moves them with error
control, and `moving_engine` then makes a run exact by collocation.
"""
