"""periporo: extreme deformation of soils by updated-Lagrangian periporomechanics."""
