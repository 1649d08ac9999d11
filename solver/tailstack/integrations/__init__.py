"""Files of other programs, STEP and calibration cages, into designs and back; the core imports nothing of it."""
