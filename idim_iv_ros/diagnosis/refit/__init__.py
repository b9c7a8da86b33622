"""The nominal model fitted anew: what every cause is tried beside."""
