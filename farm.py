#!/usr/bin/env python3
"""The one command: `python3 farm.py up` installs Rayfarm into .venv (once) and starts the farm.

    python3 farm.py up                     the farm and its page; a second start takes seconds
    python3 farm.py install [--no-kernels|--all-kernels]
                                           installs only, and compiles the kernels for most scenes, so that the first picture
                                           waits for nothing; or none of them, or also those for motion blur and media
    python3 farm.py render|submit|info ... any other command of `rayfarm`
    python3 farm.py test [--long] [...]    installs what the tests need and runs all tests and checks; --long adds exhaustive
                                           statistics, installations and comparisons; with more arguments, those go to pytest,
                                           and the checks are left out
    python3 farm.py check                  the checks alone: style, types and imports
    python3 farm.py sheets [name ...]      the picture sheets of docs/, rendered again
    python3 farm.py example-pictures       the pictures of the examples that the page shows
    python3 farm.py film                   our shot as a film, by the farm that runs here
    python3 farm.py page-pictures          pictures of the page while that farm renders
    python3 farm.py peers [...]            our pictures beside Mitsuba's and Blender's (installs Blender: 1 GB)
    python3 farm.py bench [name ...]       the benchmarks; --help lists them
    python3 farm.py bench peers [--quick]  against Mitsuba, Embree and Cycles, by a table (hours; installs Embree and Blender)
    python3 farm.py bench hard [--quick]   hard light against Mitsuba, Cycles and LuxCore (hours; installs Blender and LuxCore)

Needs Python 3.11, 3.12 or 3.13 and nothing else. Only the standard library is used here, and only what every Python 3 parses,
so that a wrong version gets a sentence and not a traceback.
"""

import ast
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
SOURCES = ("rayfarm", "renderer", "protocol", "telemetry", "service", "worker")
PYTHONS = ((3, 13), (3, 12), (3, 11))
FOR_TESTS = ("test",)
FOR_BENCHMARKS = ("docs", "test")
TEST_PROCESSES = 7  # one for each of the parts in tests/parts.py; many tests mostly wait
# Scripts that make the pictures of docs/, and their requirements.
HOURS_LONG = ("hard", "kernels", "peers")  # benchmarks
PICTURES = {
    "sheets": ("scenes", ()),
    "example-pictures": ("scenes", ()),
    "film": ("scenes", ()),
    "page-pictures": ("docs", FOR_TESTS),
}
TYPESCRIPT = VENV / "typescript"
CYCLES = ROOT / ".venv-cycles"
# As in renderer/arrays/scene_features.py: scenes without motion and media
FIRST_KERNELS = "plain,full"
BLENDER = "bpy>=4.5,<4.6"  # a long-term support release, for Python 3.11 only
BLENDERPROC_VENV = ROOT / ".venv-blenderproc"
# What its modules import; it would install pinned versions into Blender's own Python. bpy needs this NumPy.
BLENDERPROC = ("blenderproc>=2.8,<3", "numpy<2", "gitpython", "h5py", "imageio", "opencv-contrib-python-headless<4.12", "rich",
               "scipy", "trimesh")  # fmt: skip
EMBREE = ROOT / ".venv-embree"
EMBREEX = "embreex>=4.4,<5"
LUXCORE_VENV = ROOT / ".venv-luxcore"
LUXCORE = ("pyluxcore>=2.11,<2.12", "numpy")


def main():
    """Installs if needed, then runs the given command."""
    arguments = sys.argv[1:]
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 0 if arguments else 2
    find_python()
    command, rest = arguments[0], arguments[1:]
    if command == "test":
        programs = threading.Thread(target=need_programs)
        programs.start()
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # tests start a hundred processes from the same sources
        kernels = []
        extras = FOR_BENCHMARKS if "--long" in rest else FOR_TESTS
        python = install(extras, begin=lambda python: kernels.extend(start_kernels(python, rest)))
        programs.join()
        return run_tests(python, rest, kernels)
    if command == "check":
        return run_checks(install(FOR_TESTS))
    if command in PICTURES:
        folder, extras = PICTURES[command]
        program = str(ROOT / folder / (command.replace("-", "_") + ".py"))
        return subprocess.call([str(install(extras)), program, *rest], env=dict(os.environ, PYTHONPATH=str(ROOT)))
    if command == "peers":
        return run_peers(install(FOR_TESTS), rest)
    if command == "bench":
        return run_benchmarks(rest)
    if command == "install":
        return install_alone(rest)
    install()
    program = str(VENV / "bin" / "rayfarm")
    return os.execve(program, [program, *arguments], dict(os.environ, RAYFARM_PROGRAM="python3 farm.py"))


def print_progress(text):
    """Prints a progress line."""
    print("farm.py: " + text, file=sys.stderr, flush=True)


def fail(text):
    """Exits with an error sentence."""
    print_progress(text)
    sys.exit(1)


def find_python():
    """Returns if this Python is supported; otherwise restarts the program with a supported one, or exits with an error."""
    if sys.version_info[:2] in PYTHONS:
        return
    for version in PYTHONS:
        other = shutil.which("python{}.{}".format(*version))
        # Version managers have shims for versions that they cannot run here.
        if other and subprocess.call([other, "-c", "pass"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0:
            os.execv(other, [other, str(Path(__file__).resolve()), *sys.argv[1:]])
    mine = "{}.{}".format(*sys.version_info[:2])
    fail(
        "This is Python "
        + mine
        + "; Rayfarm needs Python 3.11, 3.12 or 3.13. Install one (Debian: apt install python3.11 python3.11-venv)."
    )


def install(extras=(), begin=None):
    """Returns the environment's Python with Rayfarm and these extras installed; fast if nothing has changed.

    begin: called with that Python as soon as Rayfarm can be imported, while the extras may still have to be installed.
    """
    python = VENV / "bin" / "python"
    stamp = VENV / "rayfarm-stamp"
    known = stamp.read_text().split() if stamp.is_file() else []
    if known[:1] == [installation_hash()] and set(extras) <= set(known[1:]) and python.exists():
        if begin is not None:
            begin(python)
        return python
    begun = time.monotonic()
    has_environment = is_usable(python)
    # In advance, since with PYTHONDONTWRITEBYTECODE each process would compile all modules again; and while a single process
    # makes the environment, whose Python will be this one.
    compiler = python if has_environment else sys.executable
    sources = compile_modules(compiler, *(str(ROOT / name) for name in SOURCES))
    if not has_environment:
        make_environment()
        known = []
    extras = sorted(set(extras) | (set(known[1:]) & set(FOR_BENCHMARKS)))
    print_progress("installing Rayfarm's packages into .venv (once; up to a minute) ...")
    if begin is not None:
        install_packages(python, [])
        begin(python)
    install_packages(python, extras)
    sources.wait()
    if "test" not in extras:  # tests import a small part of what they install, and compile that when they import it
        compile_modules(python, "-j", "0", *(str(path) for path in VENV.glob("lib/python*/site-packages"))).wait()
        # The digest of the sources, part of a worker's kind, is cached beside them; otherwise the first start computes it.
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.call([str(python), "-c", "from renderer import jit; jit.kind()"], cwd=str(ROOT), **quiet)
    stamp.write_text(" ".join([installation_hash(), *extras]) + "\n")
    print_progress(f"installed after {time.monotonic() - begun:.0f} s")
    return python


def compile_modules(python, *arguments):
    """Starts compiling the Python modules below some folders, apart from tests; returns the process."""
    command = [str(python), "-m", "compileall", "-q", "-x", "/tests/", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def install_packages(python, extras):
    """Installs Rayfarm's packages and those of its extras."""
    target = str(ROOT) + ("[{}]".format(",".join(extras)) if extras else "")
    arguments = ["--editable", target, "--constraint", str(ROOT / "constraints.txt")]
    if not uv(python, arguments):
        pip(python, ["install", "--no-compile", *arguments])


def install_alone(arguments):
    """Runs the command `install`: installs what other commands install at first use, and compiles kernels."""
    wanted = {"--no-kernels": None, "--all-kernels": [], "": ["--kernels", FIRST_KERNELS]}
    if len(arguments) > 1 or "".join(arguments) not in wanted:
        fail("install takes --no-kernels or --all-kernels, not " + " ".join(arguments))
    python, options = install(), wanted["".join(arguments)]
    if options is None:
        return 0
    print_progress("getting the kernels ready (once for each state of the sources; a minute or more) ...")
    done = subprocess.call([str(python), "-m", "renderer.precompile", *options], cwd=str(ROOT), stdout=sys.stderr)
    if done != 0:
        print_progress("the kernels are not ready: they are compiled when a picture first wants them. The last words are above.")
    return done


def installation_hash():
    """Returns a hash of the installation's inputs: requirements, and the environment's Python and location."""
    files = [ROOT / "pyproject.toml", ROOT / "constraints.txt", VENV / "pyvenv.cfg"]
    return hashlib.sha256(b"".join(path.read_bytes() if path.is_file() else b"-" for path in files)).hexdigest()


def is_usable(python):
    """Returns True if .venv works, has a supported Python, and was created at this path: environments cannot be moved."""
    config = VENV / "pyvenv.cfg"
    if not config.is_file() or str(VENV) not in config.read_text() or not python.exists():
        return False
    program = "import sys, pip; sys.exit(sys.version_info[:2] not in " + repr(PYTHONS) + ")"
    return subprocess.call([str(python), "-c", program], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0


def make_environment():
    """Creates .venv anew. If the Debian package for virtual environments is missing, installs it or prints how to."""
    print_progress("making a Python environment in .venv ...")
    shutil.rmtree(VENV, ignore_errors=True)
    command = [sys.executable, "-m", "venv", str(VENV)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode == 0:
        return
    package = "python{}.{}-venv".format(*sys.version_info[:2])
    if may_install():
        apt_install(package)
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode != 0:
        shutil.rmtree(VENV, ignore_errors=True)
        fail("Python cannot make an environment here. On Debian: apt install " + package + "\n" + done.stdout.decode())


def uv(python, arguments):
    """Installs packages with uv, which takes a fifth of pip's time. Returns False if that fails and pip must install them.

    uv itself is installed by pip, and uses the package index that pip is configured for.
    """
    version = next(line for line in (ROOT / "constraints.txt").read_text().splitlines() if line.startswith("uv=="))
    quiet = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "check": False, "universal_newlines": True}
    own_pip = [str(python), "-m", "pip", "--disable-pip-version-check", "--no-input"]
    configuration = subprocess.run([*own_pip, "config", "list"], **quiet).stdout
    program = python.parent / "uv"
    if ".no-index=" in configuration:
        return False
    if not program.exists() and subprocess.run([*own_pip, "install", "--no-compile", version], **quiet).returncode != 0:
        return False
    environment = dict(os.environ)
    for line in configuration.splitlines():
        key, _, value = line.partition("=")
        if key.endswith(".index-url"):
            environment.setdefault("UV_DEFAULT_INDEX", value.strip("'"))
    command = [str(program), "pip", "install", "--python", str(python), *arguments]
    # On a terminal uv shows its progress.
    done = subprocess.run(command, env=environment, **({"check": False} if sys.stderr.isatty() else quiet))
    if done.returncode != 0:
        print_progress("uv could not install them; trying pip.\n" + (done.stdout or "")[-1000:])
    return done.returncode == 0


def pip(python, arguments):
    """Runs pip with progress on one line; prints all of its output if it fails."""
    command = [str(python), "-m", "pip", "--disable-pip-version-check", "--no-input", *arguments, "--progress-bar", "off"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
    lines = []
    packages = 0
    shown = time.monotonic()
    for line in process.stdout:
        lines.append(line)
        words = line.split()
        if words[:1] == ["Collecting"]:
            packages += 1
        interesting = words[:1] in (["Collecting"], ["Downloading"], ["Building"]) or words[:2] == ["Installing", "collected"]
        if interesting and sys.stderr.isatty():
            what = "installing" if words[0] == "Installing" else " ".join(words[:2])
            sys.stderr.write(f"\r\033[K  packages so far: {packages}, {what[:60]}")
            sys.stderr.flush()
        elif interesting and (time.monotonic() - shown > 10 or words[0] == "Installing"):
            shown = time.monotonic()
            print_progress(f"  packages so far: {packages}" + (", installing them" if words[0] == "Installing" else ""))
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
    if process.wait() != 0:
        sys.stderr.write("".join(lines[-30:]))
        fail("pip could not install Rayfarm's packages; its last words are above. Check the network, then start again.")


def may_install():
    """Returns True if Debian packages can be installed here."""
    return hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get") is not None


def apt_install(package):
    """Installs a Debian package; returns whether that succeeded."""
    print_progress("installing Debian's " + package + " ...")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    environment = dict(os.environ, DEBIAN_FRONTEND="noninteractive")
    command = ["apt-get", "-o", "DPkg::Lock::Timeout=600", "install", "-y", "--no-install-recommends", package]
    if subprocess.call(command, env=environment, **quiet) == 0:
        return True
    subprocess.call(["apt-get", "update"], env=environment, **quiet)
    return subprocess.call(command, env=environment, **quiet) == 0


def start_kernels(python, arguments):
    """Starts compiling the kernels of the whole default run, on two processors; returns the processes.

    First of all, since a test that needs a kernel before it is ready compiles it at the tests' low priority.
    """
    if [a for a in arguments if a != "--long"]:
        return []
    return [ParallelProcess(f"kernels ({name})", [str(python), "-m", "tests.kernels", name]) for name in ("pool", "path")]


def run_tests(python, arguments, kernels):
    """Runs all tests, with the checks and `kernels` in parallel. pytest's summary line comes last."""
    need_typescript()
    is_long = "--long" in arguments
    arguments = [a for a in arguments if a != "--long"]
    is_whole = not arguments
    # Checks have the tests' priority; otherwise they would run on alone when the tests have ended.
    beside = [*kernels, *(start_checks(python, nice(10), is_long) if is_whole else [])]
    pytest = [*(nice(10) if is_whole else []), str(python), "-m", "pytest", *([] if is_long else ["-m", "not long"])]
    failed = subprocess.call([*pytest, "-n", str(TEST_PROCESSES), *arguments], cwd=str(ROOT))
    return max([failed, *(each.result() for each in beside)])


def run_checks(python):
    """Runs only the checks: style, types and imports."""
    need_npm()
    need_typescript()
    return max([each.result() for each in start_checks(python)])


def nice(priority):
    """Returns the prefix that runs a command at a lower priority, e.g. ["nice", "-n", "5"]; empty where `nice` is missing."""
    return ["nice", "-n", str(priority)] if shutil.which("nice") else []


def start_checks(python, prefix=(), is_long=False):
    """Starts the static checks, each behind `prefix`; with `is_long` also mypy, which takes eight times as long as Zuban."""
    imports = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports())"
    checks = [
        ParallelProcess("types", [*prefix, str(python.parent / "zmypy"), "--python-executable", str(python)]),
        ParallelProcess("ruff check", [*prefix, str(python), "-m", "ruff", "check", "."]),
        ParallelProcess("ruff format", [*prefix, str(python), "-m", "ruff", "format", "--check", "."]),
        ParallelProcess("import contracts", [*prefix, str(python), "-c", imports]),
    ]
    if is_long:
        checks.append(ParallelProcess("mypy", [*prefix, str(python), "-m", "mypy"]))
    compiler = TYPESCRIPT / "node_modules" / ".bin" / "tsc"
    if compiler.exists():
        checks.append(ParallelProcess("types of web/", [*prefix, str(compiler), "--project", str(ROOT / "web")]))
    elif os.environ.get("CI"):
        fail("TypeScript is not installed; where $CI is set the types of web/ must be checked.")
    return checks


class ParallelProcess:
    """A process that runs in parallel with the tests. Its output is printed only if it fails."""

    def __init__(self, name, command):
        self.name = name
        self.output = tempfile.TemporaryFile()  # noqa: SIM115 - `result` closes it
        self.process = subprocess.Popen(
            command, cwd=str(ROOT), stdin=subprocess.DEVNULL, stdout=self.output, stderr=subprocess.STDOUT
        )

    def result(self):
        """Waits for the process; returns 1 if it failed, else 0."""
        code = self.process.wait()
        if code != 0:
            self.output.seek(0)
            print_progress("{} failed:\n{}".format(self.name, self.output.read().decode(errors="replace")))
        self.output.close()
        return int(code != 0)


def run_peers(python, arguments):
    """Runs the tests that compare our pictures with other renderers, including long ones."""
    environment = dict(os.environ)
    if "RAYFARM_BPY_PYTHON" not in environment:
        environment["RAYFARM_BPY_PYTHON"] = str(install_blender())
    return subprocess.call(
        [str(python), "-m", "pytest", "-s", *(arguments or [str(ROOT / "tests" / "peers")])], cwd=str(ROOT), env=environment
    )


def install_blender():
    """Returns a Python with Blender as a module, in a separate environment, as it needs another numpy than Rayfarm."""
    if imports(CYCLES, "bpy"):
        return CYCLES / "bin" / "python"
    print_progress("installing Blender as a Python module into .venv-cycles (once; 370 MB are fetched) ...")
    return install_apart(CYCLES, python_for_blender(), BLENDER)


def install_blenderproc():
    """Returns a Python with BlenderProc and Blender as a module, in a separate environment."""
    if imports(BLENDERPROC_VENV, "bpy, trimesh"):
        return BLENDERPROC_VENV / "bin" / "python"
    print_progress("installing BlenderProc and Blender into .venv-blenderproc (once; 500 MB are fetched) ...")
    return install_apart(BLENDERPROC_VENV, python_for_blender(), BLENDER, *BLENDERPROC)


def python_for_blender():
    """Returns the path of Python 3.11, for which Blender's module is made; fails if there is none."""
    maker = shutil.which("python3.11")
    if maker is None:
        fail("Blender's module needs Python 3.11 beside this one. On Debian: apt install python3.11 python3.11-venv")
    return maker


def install_embree():
    """Returns a Python with Embree, in a separate environment, as trimesh would use it in Rayfarm's."""
    if imports(EMBREE, "embreex"):
        return EMBREE / "bin" / "python"
    print_progress("installing Embree into .venv-embree (once; 20 MB are fetched) ...")
    return install_apart(EMBREE, sys.executable, EMBREEX)


def install_luxcore():
    """Returns a Python with LuxCore, in a separate environment."""
    if imports(LUXCORE_VENV, "os, numpy, pyluxcore; os._exit(0)"):  # it crashes when Python ends
        return LUXCORE_VENV / "bin" / "python"
    print_progress("installing LuxCore into .venv-luxcore (once; 150 MB are fetched) ...")
    return install_apart(LUXCORE_VENV, sys.executable, *LUXCORE)


def imports(folder, module):
    """Returns True if the virtual environment in `folder` works and contains a module."""
    python = folder / "bin" / "python"
    return python.exists() and subprocess.call([str(python), "-c", "import " + module], stdout=subprocess.DEVNULL) == 0


def install_apart(folder, maker, *packages):
    """Creates a separate environment with some packages and their dependencies."""
    python = folder / "bin" / "python"
    shutil.rmtree(str(folder), ignore_errors=True)
    subprocess.check_call([maker, "-m", "venv", str(folder)])
    pip(python, ["install", *packages])
    return python


def run_benchmarks(arguments):
    """Runs all benchmarks or the named ones; those that take hours only by name."""
    folder = ROOT / "tests" / "benchmarks"
    known = {path.stem[len("bench_") :]: path for path in sorted(folder.glob("bench_*.py"))}
    names = next((i for i, a in enumerate(arguments) if a not in known), len(arguments))
    wanted, options = arguments[:names], arguments[names:]  # a benchmark may take arguments of its own, such as files
    if options and not wanted and not options[0].startswith("-"):
        fail("There is no benchmark " + options[0] + "; known are " + ", ".join(known) + ".")
    if options and not wanted:
        print(
            "python3 farm.py bench [name ...] [its options]; each tells its own by --help. Without a name: all but "
            + ", ".join(HOURS_LONG)
            + ".\n"
        )
        width = max(map(len, known)) + 2
        for name, path in known.items():
            print(f"  {name:<{width}}{ast.get_docstring(ast.parse(path.read_text())).splitlines()[0]}")
        return 0 if {"-h", "--help"} & set(options) else 2
    python = install(() if wanted == ["files"] else FOR_BENCHMARKS)
    results = []
    for name in wanted or [name for name in known if name not in HOURS_LONG]:
        path = known[name]
        print_progress("benchmark " + name)
        results.append(
            subprocess.call([str(python), str(path), *options], cwd=str(ROOT), env=dict(os.environ, PYTHONPATH=str(ROOT)))
        )
    return results[0] if len(results) == 1 else int(any(results))  # some have exit codes of their own, such as "unfinished"


def need_programs():
    """Ensures that the programs that tests start are installed: Chromium, PostgreSQL, Node.js and TypeScript's compiler."""
    need_chromium()
    need_postgresql()
    need_npm()
    need_typescript()


def need_npm():
    """Ensures that npm is installed, and Node.js, which it depends on; may fail."""
    if shutil.which("npm") is None and may_install():
        apt_install("npm")


def need_chromium():
    """Ensures that Debian's Chromium is installed, for the browser tests."""
    if any(shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")):
        return
    if not (may_install() and apt_install("chromium")):
        print_progress("No Chromium is installed: the browser tests are skipped. On Debian: apt install chromium")


def need_postgresql():
    """Ensures that a PostgreSQL server is installed, for tests; Debian has its programs outside the PATH."""
    if shutil.which("pg_ctl") or list(Path("/usr/lib/postgresql").glob("*/bin/pg_ctl")):
        return
    if os.environ.get("RAYFARM_TEST_DATABASE_URL") or (may_install() and apt_install("postgresql")):
        return
    print_progress(
        "No PostgreSQL is installed: jobs and migrations are tested on SQLite alone. On Debian: apt install postgresql"
    )


def need_typescript():
    """Ensures that TypeScript's compiler is installed, which checks the types of web/."""
    package = ROOT / "web" / "package.json"
    npm = shutil.which("npm")
    if npm is None:
        print_progress("Node.js is not installed: the page's logic and types are not checked. On Debian: apt install nodejs npm")
        return
    compiler = TYPESCRIPT / "node_modules" / ".bin" / "tsc"
    copied = TYPESCRIPT / "package.json"
    if compiler.exists() and copied.is_file() and copied.read_bytes() == package.read_bytes():
        return
    print_progress("installing TypeScript ...")
    TYPESCRIPT.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(str(package), str(copied))
    command = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(TYPESCRIPT)]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode != 0:
        copied.unlink()
        output = done.stdout.decode(errors="replace")[-1000:]
        print_progress("npm cannot install TypeScript: the types of web/ are not checked.\n" + output)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
