"""numba takes settings from a file of the folder in which a process starts: where kernels are kept, among others.

A repository of designs that brings one would say which machine code is loaded by the gate that judges it.
"""

from __future__ import annotations

import os

FILE = ".numba_config.yaml"


def ignore_settings_of_folder() -> None:
    """Have numba take its settings from the environment alone, in a process of ours.

    Before numba is loaded, and before there are threads: where there is such a file, it is loaded from another folder.
    """
    if not os.path.isfile(FILE):
        return
    here = os.getcwd()
    os.chdir(os.path.dirname(os.path.abspath(__file__)))
    try:
        from numba.core import config

        vars(config)["_config_fname"] = os.devnull  # no file; it is asked for again when the environment changes
    finally:
        os.chdir(here)
