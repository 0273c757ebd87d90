"""Results of engines and stationary methods: print, write, draw and read them."""
