"""Jobs: the database that holds them, the worker that takes units from it, the engines that compute them."""
