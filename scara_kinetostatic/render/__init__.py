"""What every report shares: figures, tables, pages, JSON text, quantities with units."""
