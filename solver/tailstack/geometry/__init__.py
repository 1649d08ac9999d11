"""Rotations, small displacement torsors and pinhole cameras."""
