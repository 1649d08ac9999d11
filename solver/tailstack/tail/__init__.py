"""The tail of the error norm: exact quantiles, declared laws, worst cases, bounds, risk per unit."""
