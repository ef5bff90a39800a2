"""From a scene to a simulation: the one room that knows materials, contact and input together."""
