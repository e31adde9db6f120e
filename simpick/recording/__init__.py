"""Recording: the `Recorder` protocol, a recorder that does nothing, and one that writes rerun recordings.

rerun is loaded on first use of a name that needs it; `Recorder` and `NullRecorder` never load it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
