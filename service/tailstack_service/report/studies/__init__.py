"""A study is one file: its tables, its words and its charts, for terminal, HTML, PDF and spreadsheet."""
