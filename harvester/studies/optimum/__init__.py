"""Where one parameter, or several, make a mean largest."""
