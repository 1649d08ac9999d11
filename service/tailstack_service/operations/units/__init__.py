"""How jobs are cut into units: pure functions of bytes, without database, clock or network."""
