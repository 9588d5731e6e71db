"""The design question: how many touches, on which discs, where, how hard."""
