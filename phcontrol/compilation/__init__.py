"""Laws compiled to C from the very files that run interpreted (``phcontrol[compile]``)."""
