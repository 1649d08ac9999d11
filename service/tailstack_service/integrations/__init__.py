"""What reads and writes the files of other programs.  A table of names finds it; nothing else imports it."""
