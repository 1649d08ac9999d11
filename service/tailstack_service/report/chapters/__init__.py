"""From records to chapters: one module per kind of result, and the tables that they share."""
