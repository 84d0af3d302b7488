"""HDF5, which is an extra: `pip install 'maglev-offline[exports]'`."""

from typing import Any

from maglev_offline.errors import InputError


def need_h5py(form: str) -> Any:
    """The module h5py.

    Raises
    ------
    InputError: it is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise InputError(
            f"the form {form} is HDF5, which needs the package h5py, and it is not installed.",
            where=f"--format {form}",
            todo="Install it with `pip install 'maglev-offline[exports]'`, or use --format npz.",
        ) from None
    return h5py
