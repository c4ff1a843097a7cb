"""The physics of the vibro-impact robot: parameters, slider, contacts, friction, modes and guards."""
