"""`explore`: sliders over a scene's numbers, and a picture that follows them."""
