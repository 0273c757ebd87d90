"""Tables, figures, pages and sentences made from results."""
