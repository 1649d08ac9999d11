"""What speaks with other programs: convert, UM-Bridge, MCP.  Tables of names find it; nothing else imports it."""
