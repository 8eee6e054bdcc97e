"""Libraries that only some commands need, and that come with the extra "looking"."""
import importlib


def require(module, purpose):
    """Import and return a module, or raise a ValueError that says how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ValueError(f"{purpose} needs {module.split('.')[0]}, which cannot be imported ({error}); "
                         "pip install 'openmm-helfrich[looking]' brings it") from None
