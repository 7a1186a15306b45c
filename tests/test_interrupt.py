"""Renders that end early or in odd places: Ctrl-C, cancelled, in a forked child, by several threads at once.

Frames here would take minutes; limits are far above what ending early takes and far below that.
"""

import os
import signal
import subprocess
import sys
import threading
import time
import weakref

import numpy as np
import pytest
import warp as wp

import wvr
from wvr.cached import cached_property
from wvr.cancel import Lock, cancelling
from wvr.launch import _report, get_device, in_turn, launch, launch_in_turn, reporting

TF = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.001)])
JUMP = wvr.TransferFunction([(0, "navy", 0.0), (140, "gold", 0.3), (140, "red", 0.1), (255, "white", 0.5)])
SLOW = {"integrator": wvr.Riemann(0.001), "device": "cpu", "termination": 0}
PYTHON = [sys.executable, "-c"]
# Jobs in the background are started with Ctrl-C ignored.
LISTEN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
SCENE = f"""
{LISTEN}
import os, threading, time, numpy as np, wvr
volume = wvr.datasets.load("blobs", 64)
tf = wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.001)])
camera = wvr.Camera.fit(volume)
slow = dict(integrator=wvr.Riemann(0.001), device="cpu", termination=0)
wvr.render(volume, tf, camera, (1, 1), **slow)
"""


@wp.kernel(enable_backward=False)
def fill(base: int, out: wp.array(dtype=int)):
    out[wp.tid() + base] = 1


@wp.kernel(enable_backward=False)
def pass_on(base: int, step: int, out: wp.array(dtype=int)):
    i = wp.tid() + base
    out[i] = out[i] + step


def run(code: str, *args: str) -> str:
    done = subprocess.run([*PYTHON, SCENE + code, *args], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(autouse=True)
def ctrl_c():
    """Is listened to, also where the tests run in the background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def scene():
    volume = wvr.datasets.load("blobs", 64)
    return volume, TF, wvr.Camera.fit(volume)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_forked_child_renders():
    """After a render; and while another thread is in one, of the same renderer."""
    run("""
renderer = wvr.Renderer(volume, tf, **slow)
cancel = threading.Event()
def other():
    try:
        renderer.render(camera, (512, 512), cancel=cancel)
    except wvr.Cancelled:
        pass
def child():
    pid = os.fork()
    if pid == 0:
        renderer.render(camera, (2, 2))
        os._exit(7)
    end = time.monotonic() + 20
    while time.monotonic() < end:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.kill(pid, 9)
    os.waitpid(pid, 0)
    return "never returned"
assert child() == 7
thread = threading.Thread(target=other)
thread.start()
time.sleep(0.5)
outcome = child()
cancel.set()
thread.join()
assert outcome == 7, outcome
""")


def test_no_thread_waits_for_what_another_computes_of_its_own():
    entered, go = threading.Event(), threading.Event()

    class Slow:
        def __init__(self, waits):
            self.waits = waits

        @cached_property
        def value(self):
            entered.set()
            return not self.waits or go.wait(20)

    first, second = Slow(True), Slow(False)
    threads = [threading.Thread(target=lambda one=one: one.value, daemon=True) for one in (first, second)]
    threads[0].start()
    assert entered.wait(20)
    threads[1].start()
    threads[1].join(5)
    assert vars(second)["value"] is True and "value" not in vars(first)
    go.set()
    threads[0].join()
    assert first.value is True and isinstance(Slow.value, cached_property)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("threads", [1, 5])
def test_ctrl_c_leaves_nothing_running(threads):
    run(f"""
wvr.set_num_threads({threads})
threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
start = time.monotonic()
try:
    wvr.render(volume, tf, camera, (512, 512), **slow)
    raise SystemExit("not interrupted")
except KeyboardInterrupt:
    pass
assert time.monotonic() - start < 8
used = time.process_time()
time.sleep(0.3)
assert time.process_time() - used < 0.1
start = time.monotonic()
wvr.render(volume, tf, camera, (4, 4), **slow)
assert time.monotonic() - start < 8
""")


def lets_go(*_):
    """As h5py lets go of something while it reads: what is raised where that is noticed is lost."""
    thing = Lock()
    noticed = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGINT))
    del thing
    assert noticed() is None
    time.sleep(0.5)
    return np.zeros((2, 2, 2))


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_while_samples_are_read(tmp_path, monkeypatch):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = np.zeros((2, 2, 2))
    with h5py.File(tmp_path / "a.h5") as file:
        data = file["a"]
        for name in ("read_direct", "__array__", "__getitem__"):
            monkeypatch.setattr(h5py.Dataset, name, lets_go)
        for read in (
            lambda: wvr.read(tmp_path / "a.h5"),
            lambda: wvr.as_volume(data),
            lambda: wvr.Volume(data),
            lambda: wvr.Segmentation(data, {}),
            lambda: wvr.open(data).loaded(),
        ):
            with pytest.raises(KeyboardInterrupt):
                read()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_while_xarray_reads(monkeypatch):
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray(np.zeros((2, 2, 2)), dims=("z", "y", "x"))
    monkeypatch.setattr(xarray.Variable, "data", property(lets_go))
    with pytest.raises(KeyboardInterrupt):
        wvr.as_volume(array)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_on_the_command_line(tmp_path):
    command = f"""{LISTEN}
import sys, warp as wp
from wvr.cli import main
launch = wp.Launch.launch
wp.Launch.launch = lambda *args: (print("launched", file=sys.stderr, flush=True), launch(*args))
sys.argv[0] = "wvr"
sys.exit(main())"""
    args = ["render", "blobs", "--integrator", "riemann:0.001", "--termination", "0", "-o", str(tmp_path / "a.png")]
    process = subprocess.Popen([*PYTHON, command, *args], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert any(line == "launched\n" for line in process.stderr)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 130 and out == "" and "Traceback" not in err


def test_ctrl_c_while_threads_start():
    """What started before its pool knew of it does not keep the process from ending."""
    command = """
import threading, wvr
volume = wvr.datasets.load("blobs", 16)
renderer = wvr.Renderer(volume, wvr.TransferFunction([(0, "navy", 0), (255, "gold", 0.3)]))
start = threading.Thread.start
def interrupted(self):
    start(self)
    threading.Thread.start = start
    raise KeyboardInterrupt
wvr.set_num_threads(2)
threading.Thread.start = interrupted
try:
    renderer.render(wvr.Camera.fit(volume), (32, 32))
except KeyboardInterrupt:
    print("interrupted")
"""
    done = subprocess.run([*PYTHON, command], capture_output=True, text=True, timeout=60)
    assert done.stdout == "interrupted\n", done.stderr


class CtrlC:
    """Pressed at the n-th step of what this thread does in some files: before a line, and on the way in and out."""

    def __init__(self, n, *files):
        self.left, self.files = n, files

    def __call__(self, frame, event, arg):
        return self.step(frame, event, arg) if frame.f_code.co_filename.endswith(self.files) else None

    def step(self, frame, event, arg):
        self.left -= event != "exception"
        if self.left == 0 and event != "exception":
            sys.settrace(None)
            raise KeyboardInterrupt
        return self.step

    def __enter__(self):
        sys.settrace(self)

    def __exit__(self, *exception):
        sys.settrace(None)


@pytest.mark.parametrize(("what", "every"), [("frame", 17), ("depth", 17), ("bricks", 3)])
def test_ctrl_c_at_any_step_leaves_nothing_torn(what, every, threads):
    """What is kept, and locked, is as good as new: the next frames are those of a new renderer."""
    threads(1)
    options = {"device": "cpu"} | ({"memory_limit": "1 MiB"} if what == "bricks" else {})
    # With a jump, as other bricks that clips cut.
    tf = JUMP if what == "bricks" else TF
    volumes = [wvr.Volume(wvr.datasets.load("blobs", 12).numpy()[::step].copy()) for step in (1, -1)]
    clips = [wvr.ClipVolume(volume, 100) for volume in (*volumes, wvr.datasets.load("blobs", 12))]
    camera = wvr.Camera.fit(volumes[0])

    def seen(renderer, volume, clip):
        renderer.volume, renderer.clip = volumes[volume], clips[clip]
        image = renderer.render(camera, (3, 3))
        return image.depth(1e-4) if what == "depth" else image.rgba

    # Bricks stay with their volume.
    scenes = [(0, 0), (int(what != "bricks"), 1), (0, 2)]
    expected = {scene: seen(wvr.Renderer(volumes[0], tf, **options), *scene) for scene in scenes}
    renderer = wvr.Renderer(volumes[0], tf, **options)
    pressed, kept = 0, []
    for n in range(1, 10**6, every):
        seen(renderer, *scenes[0])
        try:
            with CtrlC(n, "keep.py", "cancel.py", "store.py", "contextlib.py"):
                seen(renderer, *scenes[1])
            break
        except KeyboardInterrupt as error:
            kept.append(error)  # as the interpreter does, with all that it came through
            pressed += 1
        for scene in (scenes[2], scenes[1]):
            assert np.array_equal(seen(renderer, *scene), expected[scene], equal_nan=True), n
    assert pressed > 10


def test_ctrl_c_at_any_step_of_a_launch(threads):
    """The thread that launches works with those of its pool, and waits for no other."""
    threads(2)
    out = wp.zeros(4, dtype=int, device="cpu")
    ended: list[str] = []

    def pressed(n):
        try:
            with CtrlC(n, "launch.py"):
                launch_in_turn(pass_on, 4, [(1,)], [out], get_device("cpu"))
        except KeyboardInterrupt:
            return ended.append("pressed")
        ended.append("done")

    for n in range(1, 10**6):
        thread = threading.Thread(target=pressed, args=(n,), daemon=True)
        thread.start()
        thread.join(20)
        assert len(ended) == n
        if ended[-1] == "done":
            break
    assert n > 30


def test_ctrl_c_while_samples_are_copied_anew(monkeypatch):
    """What changed is asked for again, until all that was made of other samples is forgotten; as after an error."""
    source = np.zeros((6, 6, 6), ">f4")
    volume = wvr.Volume(source)
    renderer, camera = (
        wvr.Renderer(volume, wvr.TransferFunction([(0, "red", 0), (1, "red", 0.9)])),
        wvr.Camera.fit(volume),
    )
    assert renderer.render(camera, (3, 3)).rgba.max() == 0
    copyto = np.copyto

    def pressed(*arrays):
        copyto(*arrays)
        raise KeyboardInterrupt

    source[...] = 1
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(np, "copyto", pressed)
        renderer.render(camera, (3, 3))
    assert renderer.render(camera, (3, 3)).rgba.max() > 0.9
    source[0] = np.nan
    for _ in range(2):
        with pytest.raises(ValueError, match="NaN or infinite"):
            renderer.render(camera, (3, 3))


@pytest.mark.parametrize("how", ["launch", "in turn"])
@pytest.mark.parametrize("count", [1, 3])
def test_an_error_in_a_strip_ends_the_others(how, count, threads, monkeypatch):
    threads(count)
    launch_once = wp.Launch.launch
    begun = []

    def fails(command, *args):
        begun.append(None)
        if len(begun) == 4:
            raise OSError("no more")
        time.sleep(0.01)
        launch_once(command, *args)

    monkeypatch.setattr(wp.Launch, "launch", fails)
    out = wp.zeros(1000, dtype=int, device="cpu")
    with pytest.raises(OSError, match="no more"):
        if how == "launch":
            launch(fill, 1000, [out], get_device("cpu"))
        else:
            launch_in_turn(pass_on, 1000, [(k,) for k in range(100)], [out], get_device("cpu"))
    after = len(begun)
    assert after <= 4 + 2 * count
    time.sleep(0.05)
    assert len(begun) == after


def test_progress(scene, threads):
    """Rises to 1 on the thread that renders, in bricks too, and changes no pixel; what it raises ends the frame."""
    threads(2)
    volume, tf, camera = scene
    renderer = wvr.Renderer(volume, tf, **SLOW)
    told = []
    image = renderer.render(camera, (24, 24), progress=lambda share: told.append((share, threading.get_ident())))
    shares = [share for share, _ in told]
    assert shares[-1] == 1 and shares == sorted(shares) and any(0 < share < 0.95 for share in shares)
    assert {ident for _, ident in told} == {threading.get_ident()}
    assert np.array_equal(image.rgba, renderer.render(camera, (24, 24)).rgba)
    told.clear()
    bricks = wvr.Renderer(volume, tf, memory_limit="4 MiB", device="cpu")
    bricks.render(camera, (64, 64), progress=lambda share: told.append((share, 0)))
    shares = [share for share, _ in told]
    assert shares[-1] == 1 and shares == sorted(shares)

    def enough(share):
        if share > 0.2:
            raise StopIteration("enough")

    start = time.monotonic()
    with pytest.raises(StopIteration, match="enough"):
        renderer.render(camera, (512, 512), progress=enough)
    assert time.monotonic() - start < 60
    with pytest.raises(TypeError, match="progress must be a function of the share that is done, or None, got True"):
        renderer.render(camera, (4, 4), progress=True)


def test_progress_that_renders(scene, threads):
    """Other images, and depths of them, are no part of what is told of; the renderer itself says that it is busy."""
    threads(2)
    volume, tf, camera = scene
    renderer = wvr.Renderer(volume, tf, **SLOW)
    plain = renderer.render(camera, (16, 16))
    depths = []

    def other(share):
        depths.append(wvr.render(volume, tf, camera, (8, 8)).depth() + plain.depth()[:8, :8])

    assert np.array_equal(renderer.render(camera, (16, 16), progress=other).rgba, plain.rgba)
    assert len(depths) > 0 and all(np.array_equal(each, depths[0], equal_nan=True) for each in depths)
    with pytest.raises(RuntimeError, match="busy with a frame of this thread"):
        renderer.render(camera, (16, 16), progress=lambda share: renderer.render(camera, (8, 8)))
    assert np.array_equal(renderer.render(camera, (16, 16)).rgba, plain.rgba)


def test_cancelled_by_progress(scene):
    """Until the end, by the last call before it too; with 1 the image is there."""
    volume, tf, camera = scene
    late, told = threading.Event(), []
    image = wvr.render(volume, tf, camera, (8, 8), cancel=late, progress=lambda share: share == 1 and late.set())
    assert late.is_set() and np.array_equal(image.rgba, wvr.render(volume, tf, camera, (8, 8)).rgba)
    with pytest.raises(wvr.Cancelled), cancelling(late), reporting(told.append):
        pass
    assert told == []
    late.clear()
    with cancelling(late), reporting(lambda share: late.set()):
        pass


def test_parts_of_progress_are_in_turn():
    """Nested, by their weights, and nothing is left of one that failed."""
    shares = []
    with reporting(shares.append):
        for _ in in_turn("ab", (3, 1)):
            for _ in in_turn("cd"):
                shares.append(_report.get()[1:])
    assert shares == [(0, 0.375), (0.375, 0.75), (0.75, 0.875), (0.875, 1), 1.0]
    with pytest.raises(ZeroDivisionError), reporting(shares.append):
        for _ in in_turn("ab"):
            1 / 0  # noqa: B018
    assert _report.get() is None


@pytest.mark.parametrize("count", [1, 2])
def test_cancel(scene, count, threads):
    """Ends a long frame; the renderer then renders what a new one does."""
    threads(count)
    volume, tf, camera = scene
    renderer = wvr.Renderer(volume, tf, **SLOW)
    event = threading.Event()
    threading.Timer(0.5, event.set).start()
    start = time.monotonic()
    with pytest.raises(wvr.Cancelled):
        renderer.render(camera, (512, 512), cancel=event)
    assert time.monotonic() - start < 8
    event.clear()
    renderer.integrator = wvr.Riemann(0.5)
    again = renderer.render(camera, (8, 8), cancel=event)
    assert np.array_equal(again.rgba, wvr.render(*scene, (8, 8), **SLOW | {"integrator": wvr.Riemann(0.5)}).rgba)


def test_cancelled_rays_stay_in_the_image(blobs, monkeypatch):
    """Rays that are on their way when it is cancelled are written where they are, or nowhere: never below the image."""
    made = []

    def guarded(shape, **options):
        if shape != (256, 256):
            return empty(shape, **options)
        array = empty((257, 256), **options)
        array.zero_()
        made.append(array)
        return array[:256]

    empty = wp.empty
    renderer = wvr.Renderer(blobs, wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", 0.1)]), device="cpu")
    camera = wvr.Camera.fit(blobs)
    renderer.render(camera, (256, 256))
    monkeypatch.setattr(wp, "empty", guarded)
    ended = 0
    for wait in np.linspace(0.001, 0.03, 12):
        event = threading.Event()
        timer = threading.Timer(wait, event.set)
        timer.start()
        try:
            renderer.render(camera, (256, 256), cancel=event)
        except wvr.Cancelled:
            ended += 1
        timer.cancel()
    assert ended > 2 and made
    for array in made:
        assert not np.any(array.numpy()[256].view(np.uint8))


@pytest.mark.parametrize("options", [{}, {"integrator": wvr.Preintegrated(1.0)}, {"shadows": wvr.ConvolutionShadows()}])
def test_cancelled_at_any_launch_keeps_nothing_half_made(options):
    """Also where buffers of the frame before are built over."""

    class After:
        """Set from the n-th time on that it is looked at."""

        def __init__(self, n):
            self.left = n

        def is_set(self):
            self.left -= 1
            return self.left < 0

    first, second = wvr.datasets.load("blobs", 24), wvr.Volume(255 - wvr.datasets.load("blobs", 24).numpy())
    camera = wvr.Camera.fit(first)
    expected = [wvr.render(one, TF, camera, (8, 8), device="cpu", **options).rgba for one in (first, second)]
    renderer = wvr.Renderer(first, TF, device="cpu", **options)
    for n in (*range(12), 20, 40):
        for volume, rgba in zip((first, second), expected, strict=True):
            renderer.volume = volume
            try:
                renderer.render(camera, (8, 8), cancel=After(n))
            except wvr.Cancelled:
                renderer.volume = first
                assert np.array_equal(renderer.render(camera, (8, 8)).rgba, expected[0])
                renderer.volume = volume
            assert np.array_equal(renderer.render(camera, (8, 8)).rgba, rgba)


def test_cancel_before_it_begins(scene):
    event = threading.Event()
    event.set()
    with pytest.raises(wvr.Cancelled):
        wvr.render(*scene, (4, 4), device="cpu", cancel=event)
    with pytest.raises(wvr.Cancelled):
        wvr.single_scattering(*scene, (4, 4), device="cpu", cancel=event)
    with cancelling(event), pytest.raises(wvr.Cancelled):
        launch_in_turn(pass_on, 4, [(1,)], [wp.zeros(4, dtype=int, device="cpu")], get_device("cpu"))


def test_cancel_of_single_scattering(scene):
    """Also in the middle of a ray, of which each sample has many rays to the light."""
    event = threading.Event()
    threading.Timer(0.5, event.set).start()
    start = time.monotonic()
    with pytest.raises(wvr.Cancelled):
        wvr.single_scattering(*scene, (8, 8), directions=2**16, step=0.1, device="cpu", cancel=event)
    assert time.monotonic() - start < 10


@pytest.mark.parametrize("call", [wvr.render, wvr.single_scattering])
def test_cancel_must_be_an_event(scene, call):
    with pytest.raises(TypeError, match=r"cancel must be a threading.Event or None, got True"):
        call(*scene, (4, 4), device="cpu", cancel=True)


def test_a_cancelled_frame_does_not_wait_for_the_one_before(scene):
    event, lock, taken, done = threading.Event(), Lock(), threading.Event(), threading.Event()

    def other():
        with lock.held():
            taken.set()
            done.wait(20)

    threading.Thread(target=other).start()
    assert taken.wait(20)
    threading.Timer(0.1, event.set).start()
    with pytest.raises(wvr.Cancelled), cancelling(event), lock.held():
        pass
    assert not done.is_set()
    done.set()
    with lock.held(), pytest.raises(RuntimeError, match="busy with a frame of this thread"), lock.held():
        pass
    with lock.held():
        pass


def test_threads_that_share_a_renderer(blobs):
    """Each image is of attributes that there were, though others assign to them meanwhile."""
    camera = wvr.Camera.fit(blobs)
    functions = [wvr.TransferFunction([(0, "navy", 0.0), (255, "gold", opacity)]) for opacity in (0.1, 0.4, 0.7)]
    options = {"integrator": wvr.Preintegrated(1.0), "device": "cpu"}
    expected = [wvr.render(blobs, tf, camera, (16, 16), **options).rgba for tf in functions]
    renderer = wvr.Renderer(blobs, functions[0], **options)
    images: list[np.ndarray] = []

    def work(seed: int) -> None:
        for k in np.random.default_rng(seed).integers(3, size=15):
            renderer.transfer_function = functions[k]
            images.append(renderer.render(camera, (16, 16)).rgba)

    workers = [threading.Thread(target=work, args=(seed,)) for seed in range(4)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(images) == 60
    assert all(any(np.array_equal(image, one) for one in expected) for image in images)


def test_many_threads(scene, threads, monkeypatch):
    """No more than make sense, and all items are done."""
    few = wvr.render(*scene, (40, 40), device="cpu").rgba
    threads(100_000)
    assert wvr.get_num_threads() == max(64, os.cpu_count())
    assert np.array_equal(wvr.render(*scene, (40, 40), device="cpu").rgba, few)
    monkeypatch.setattr("wvr.launch._threads", None)
    monkeypatch.setenv("WVR_NUM_THREADS", "100000")
    assert wvr.get_num_threads() == max(64, os.cpu_count())
