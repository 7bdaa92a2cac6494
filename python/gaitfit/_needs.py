"""Packages that parts of this one need."""


def lacking(module: str, extra: str, missing: ImportError) -> ImportError:
    """The error of ``gaitfit.<module>`` without a package that the extra ``extra`` installs."""
    return ImportError(f'gaitfit.{module} needs a package that is not here ({missing}): pip install "gaitfit[{extra}]"')
