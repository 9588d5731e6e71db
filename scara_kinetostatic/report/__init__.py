"""The report of a calibration: `calibration.json`, `calibration.yaml`, `report.html` and the text for a terminal.

It reads an `Outcome` and estimates nothing. `document` makes the JSON, `parameter_file` the ROS parameters, `text` the
terminal's text, `page` with `diagnosis_section` and the pictures the page. `messages` has the sentences that text and
page share; `write` writes the files.
"""
