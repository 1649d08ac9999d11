"""First-order propagation of every error source to the tool, by the implicit function theorem."""
