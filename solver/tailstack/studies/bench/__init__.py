"""Bench measurements against prediction: the file, its levels against simulated benches, what would explain them."""
