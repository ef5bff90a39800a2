"""Motion: time integration, its stable step, relaxation, stages, and the energy of it all."""
