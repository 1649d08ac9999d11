"""Reports for people: HTML, PDF and spreadsheet, all made from the published record."""
