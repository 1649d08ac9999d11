"""The gate: designs held to a policy, with findings at the line of the offending value and an exit code."""
