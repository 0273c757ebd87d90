"""The stationary density of any device, without averaging: the Fokker–Planck equation on a grid."""
