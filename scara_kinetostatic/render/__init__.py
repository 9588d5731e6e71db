"""What every report shares: figures, tables, pages, quantities with units."""
