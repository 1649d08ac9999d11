"""The estimator as the robot runs it: resection by DLT, triangulation, the chain to the tool."""
