"""The mask and key point losses as operators of PyTorch and JAX: `meshslam.autodiff.torch`, `meshslam.autodiff.jax`.

Each module imports its framework, an extra: `pip install 'meshslam[torch]'`, `pip install 'meshslam[jax]'`.
"""

__all__: list[str] = []
