"""What a calibration prints and writes: `calibration.json`, `calibration.yaml`, `residuals.csv`, `report.html`."""
