"""Engines that move, in simulations: shaft speeds and other states of the network, integrated along time."""
