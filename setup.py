# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

from glob import glob
import importlib.util
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from setuptools import find_packages, setup

package_name = 'identnl_ros'
messages_name = 'identnl_msgs'
messages_source = Path(__file__).resolve().parent / 'msg_defs'


def colcon_build_folder():
    """Return the folder in which colcon builds this package; None if it is not colcon."""
    for entry in os.environ.get('PYTHONPATH', '').split(os.pathsep):
        if Path(entry).name == 'prefix_override':
            return Path(entry).parent
    return None


def messages_come_from_elsewhere(prefix):
    """Tell whether a ROS prefix that is in use has the message package already."""
    if (prefix / 'share/colcon-core/packages' / messages_name).exists():
        return True  # built by colcon as a package of its own, into the same prefix
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    prefixes.append(getattr(sys, 'real_prefix', sys.prefix))
    marker = Path('share/ament_index/resource_index/packages') / messages_name
    return any((Path(p) / marker).exists() for p in prefixes if p and Path(p) != prefix)


def build_messages(build_folder):
    """
    Build the message package with CMake and install it where colcon installs this package.

    colcon does not look for packages inside a package, so it does not find msg_defs in a
    checkout that lies in a workspace's src folder.
    """
    prefix = Path(sys.prefix)  # colcon sets it to the folder it installs into
    if messages_come_from_elsewhere(prefix):
        return
    folder = build_folder / messages_name
    configure = [
        'cmake', '-S', messages_source, '-B', folder, f'-DCMAKE_INSTALL_PREFIX={prefix}',
        '-DCMAKE_INSTALL_RPATH=$ORIGIN:$ORIGIN/../../..', '-DBUILD_TESTING=OFF',
        f'-DPython3_EXECUTABLE={sys.executable}',
    ]  # fmt: skip
    if importlib.util.find_spec('ros_wheels_bootstrapper'):
        configure.append(f'-DCMAKE_PROJECT_INCLUDE={messages_source / "ros_wheels.cmake"}')
    environment = dict(os.environ)
    environment['PYTHONPATH'] = os.pathsep.join(
        entry
        for entry in environment['PYTHONPATH'].split(os.pathsep)
        # these change the prefix of any Python that runs
        if Path(entry).name not in ('prefix_override', 'colcon_distutils_commands')
    )
    for command in (
        configure,
        ['cmake', '--build', folder, '--parallel', str(os.cpu_count() or 1)],
        ['cmake', '--install', folder],
    ):
        subprocess.run(command, check=True, env=environment)


def commands():
    """Return the setuptools commands that colcon runs, with the message package added."""
    build_folder = colcon_build_folder()
    if build_folder is None:
        return {}
    from setuptools.command.develop import develop
    from setuptools.command.install import install

    def with_messages(command):
        def run(self):
            command.run(self)
            # `develop` of new versions of setuptools calls for an uninstallation this way
            if not getattr(self, 'uninstall', False):
                build_messages(build_folder)

        return type(command.__name__, (command,), {'run': run})

    return {'develop': with_messages(develop), 'install': with_messages(install)}


setup(
    name=package_name,
    version=ElementTree.parse('package.xml').findtext('version'),
    packages=find_packages(include=[package_name, f'{package_name}.*']),
    package_data={package_name: ['py.typed', 'storage/message_definitions/*.msg']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{package_name}']),
        (f'share/{package_name}', ['package.xml']),
        (f'share/{package_name}/config', sorted(glob('config/*.yaml'))),
        (f'share/{package_name}/config/nodes', sorted(glob('config/nodes/*.yaml'))),
        (f'share/{package_name}/launch', sorted(glob('launch/*_launch.py'))),
    ],
    python_requires='>=3.11',
    install_requires=[
        'click',
        'lz4',
        'matplotlib',
        'mcap>=1.6',
        'numba',
        'numpy>=1.26',
        'pint',
        'pydantic>=2',
        'PyYAML',
        'rich',
        'rosbags>=0.10',
        'scipy',
        'zstandard',
    ],
    extras_require={
        # files of other programs: HDF5 and MATLAB 7.3, TDMS, Parquet
        'formats': ['h5py', 'npTDMS', 'pyarrow'],
        # acquisition devices
        'nidaqmx': ['nidaqmx'],
        'opendaq': ['opendaq'],
        'test': ['mypy', 'pytest', 'pytest-timeout', 'pytest-xdist', 'pyuff', 'ruff'],
    },
    cmdclass=commands(),
    zip_safe=False,
    maintainer='identnl_ros developers',
    maintainer_email='identnl_ros@example.com',
    description='Identifies nonlinear joint stiffness and damping of machine tools '
    'from vibration records.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'identnl = identnl_ros.cli.main:main',
            'identifier = identnl_ros.nodes.identifier:main',
            'recorder = identnl_ros.nodes.recorder:main',
            'sensor_bridge = identnl_ros.nodes.sensor_bridge:main',
            'stand = identnl_ros.nodes.stand:main',
            'transform = identnl_ros.nodes.transform:main',
        ],
        'identnl_ros.sources': [
            'bag = identnl_ros.sources.recorded:source',
            'nidaqmx = identnl_ros.sources.nidaqmx_device:source',
            'opendaq = identnl_ros.sources.opendaq_device:source',
            'simulated = identnl_ros.sources.simulated_choice:source',
            'topics = identnl_ros.nodes.topic_device:source',
        ],
    },
)
