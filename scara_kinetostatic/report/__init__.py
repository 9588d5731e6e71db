"""The outcome of a calibration for people and programs.

`document` (the result as data) <- `json_file`; `parameter_file` (ROS parameters);
`quantities` (numbers and units as people read them) <- `words` (what they mean) <- `text` (terminal)
and `html` (page, with `figures`); `write` puts the files in place, all or nothing.
"""
