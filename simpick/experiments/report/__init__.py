"""What a comparison shows: tables, plots, HTML."""
