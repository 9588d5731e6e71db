"""Builds the package with `pip install .` or, as an ament_python package of ROS 2, with `colcon build`."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'scara_kinetostatic'
ROS = ['ros-jazzy-rclpy', 'ros-jazzy-common-interfaces', 'ros-jazzy-rmw-fastrtps-cpp']
PHYSICS = ['mujoco>=3.13']  # first version with the integrator `discrete`; for the verb `mujoco` only
CLUSTER = ['dask[distributed]']  # for the verb `recalibrate`
TEST = ['pytest', 'pytest-xdist', 'hypothesis', 'ruff', 'mypy', 'types-PyYAML', 'example-robot-data']
TEST += [*PHYSICS, *CLUSTER, 'xacro']
BENCH = [
    'casadi',
    'mcap-ros2-support',
    'yourdfpy',
    'pin',
    *PHYSICS,
]  # the solvers and readers that `benchmark` compares with
DOCS = ['sphinx>=7.2', 'myst-parser>=3', 'furo', 'latex2mathml']  # the documentation site in docs/
README = Path('README.md')


def files(folder: str, pattern: str) -> list[str]:
    """Sorted paths of the files in `folder` that match `pattern`."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


setup(
    name=NAME,
    version='0.1.0',
    description='Kinetostatic calibration of a SCARA robot by touch, with the diagnosis of model errors',
    long_description=README.read_text(encoding='utf-8') if README.is_file() else '',
    long_description_content_type='text/markdown',
    author='scara_kinetostatic maintainers',
    author_email='maintainers@users.noreply.h-seed-e7f4a048.example',
    url='https://h-seed-e7f4a048.example',
    license='Apache-2.0',
    classifiers=[
        'Development Status :: 4 - Beta',
        'Environment :: Console',
        'Intended Audience :: Manufacturing',
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3 :: Only',
        *(f'Programming Language :: Python :: 3.{minor}' for minor in range(10, 14)),
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    keywords=[
        'robot calibration',
        'SCARA',
        'kinetostatic',
        'compliance',
        'backlash',
        'force sensor',
        'measurement uncertainty',
        'ROS 2',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['**/*.j2', '**/*.css', '**/*.csv', '**/*.yaml', 'py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/launch', files('launch', '*.launch.py')),
        (
            f'share/{NAME}/config',
            [file for kind in ('yaml', 'rviz', 'json', 'csv') for file in files('config', f'*.{kind}')],
        ),
        (f'share/{NAME}/config/sros2', files('config/sros2', '*.xml')),
    ],
    install_requires=[
        'numpy>=1.26',
        'scipy>=1.11',
        'pyyaml',
        'jinja2',
        'matplotlib',
        'rich',
        'threadpoolctl>=3.5',  # first that sees the libraries in the wheels of NumPy and SciPy
        'rosbags>=0.10.11',
        'mcap>=1.5',
        'lz4',
        'zstandard',
    ],
    extras_require={
        'ros': ROS,
        'urdf': [],
        'test': TEST,
        'physics': PHYSICS,
        'cluster': CLUSTER,
        'bench': BENCH,
        'docs': DOCS,
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [
            f'scara-kinetostatic = {NAME}.cli.main:command',
            f'contact_simulator = {NAME}.nodes.executables:contact_simulator',
            f'collector = {NAME}.nodes.executables:collector',
            f'calibrator = {NAME}.nodes.executables:calibrator',
            f'visualizer = {NAME}.nodes.executables:visualizer',
            f'monitor = {NAME}.nodes.executables:monitor',
            f'compensator = {NAME}.nodes.executables:compensator',
            f'contour_tracker = {NAME}.nodes.executables:contour_tracker',
            f'touch_runner = {NAME}.nodes.executables:touch_runner',
        ]
    },
)
