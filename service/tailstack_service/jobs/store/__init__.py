"""The store of jobs, their units, events and results, of keys, usage and the audit log: the only place that knows SQL.

Every function here is one short transaction.  A write by a worker names the claim that it answers for, and the claim is
checked in the same transaction: a worker that lost its unit can compute, but it cannot record.
"""
