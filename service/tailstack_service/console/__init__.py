"""What every command on a terminal shares: answers and exit codes, arguments, progress, files."""
