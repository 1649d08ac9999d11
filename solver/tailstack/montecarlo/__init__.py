"""Monte Carlo of the full nonlinear chain, written independently of the first-order model.

How finely a check may be asked for is the relative half-width of the interval of P95.
"""

PRECISION = 0.005  # when nothing else is asked for
FINEST_PRECISION = 1e-4  # what is finer takes billions of trials
MAX_TRIALS = 2**22  # a check to a precision gives up after so many, when no other number is asked for
MOST_TRIALS = 10**9  # of a check: it keeps the largest twentieth of every error's norms
