"""What is kept: jobs, their units, events, results, keys, usage.  The only place that knows SQL.

Every function here is one short transaction.  A write by a worker names the claim that it answers for, and is checked
in the same transaction: a worker that lost its unit can compute, but it cannot record.
"""
