"""From streams of joint angles and forces to touches, offline and online by the same code."""
