"""Where the poles of a law are put, and the gains of its joints that put them there."""
