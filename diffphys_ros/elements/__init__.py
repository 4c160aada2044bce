"""Finite elements of a body: outline, mesh (tetrahedra), assemble (stiffness, mass, eigenmodes); the only door to scikit-fem. plane: a flat solid that moves far."""
