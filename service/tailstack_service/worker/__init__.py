"""The worker: takes units from the database, has them computed, records what they came to."""
