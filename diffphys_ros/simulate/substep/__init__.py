"""One substep of MLS-MPM and its adjoint, as the textbook has it: transfer, forward, adjoint, contact."""
