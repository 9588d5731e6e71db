"""How results are shown, on the terminal, as a page and as JSON: `page`, with its figures (`figure`)."""
