"""Loaders of layouts that are folders of images and text files, one each."""
