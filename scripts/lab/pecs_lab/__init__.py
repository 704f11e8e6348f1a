"""Parts that benches, tools and studies share: scenes with a known truth, recordings drawn from them, sequences, peers.

Not in the wheel.
"""
