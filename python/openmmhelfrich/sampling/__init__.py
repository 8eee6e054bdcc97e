"""What happens to a membrane in an openmm.app.Simulation: observed, adapted, cooled, minimized, led to other targets,
exchanged.
"""
