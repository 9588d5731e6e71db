"""The paper's studies, redone: its algorithm, section 5.1, the design question, the gauge experiments of 5.2."""
