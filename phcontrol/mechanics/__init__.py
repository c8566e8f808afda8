"""Robot arms as port-Hamiltonian systems."""
