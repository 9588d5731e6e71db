"""Which touches to make, and how to get there: the next ones, or a whole calibration's (`optimal_design`)."""
