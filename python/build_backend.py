"""Packs the folder tvsgs into a wheel; pip calls it (PEP 517, PEP 427)."""
import base64
import hashlib
import pathlib
import re
import zipfile

HERE = pathlib.Path(__file__).resolve().parent


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    files = {f'tvsgs/{path.name}': path.read_bytes() for path in sorted(HERE.glob('tvsgs/*.py'))}
    version = re.search(rb"__version__ = '(.*)'", files['tvsgs/__init__.py'])[1].decode()
    info = f'tvsgs-{version}.dist-info'
    files[f'{info}/METADATA'] = (f'Metadata-Version: 2.1\nName: tvsgs\nVersion: {version}\nRequires-Python: >=3.9\n'
                                 'Summary: Tensor voting between Gaussian splats\nLicense: Apache-2.0\n').encode()
    files[f'{info}/WHEEL'] = b'Wheel-Version: 1.0\nGenerator: tvsgs\nRoot-Is-Purelib: true\nTag: py3-none-any\n'
    record = ''
    for name, data in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()
        record += f'{name},sha256={digest},{len(data)}\n'
    files[f'{info}/RECORD'] = (record + f'{info}/RECORD,,\n').encode()
    wheel = f'tvsgs-{version}-py3-none-any.whl'
    with zipfile.ZipFile(pathlib.Path(wheel_directory) / wheel, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return wheel
