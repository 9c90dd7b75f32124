"""Processes that fork, as multiprocessing does: a child connects anew."""

from pathlib import Path

from integration.programs import central, program

PARENT = """
    import multiprocessing
    from tca_module import connect

    def child():
        with connect("child", patience=5.0) as user:
            print(*sorted(module.name for module in user.modules()), flush=True)

    with connect("parent") as user:
        user.modules()
        one = multiprocessing.get_context("fork").Process(target=child)
        one.start()
        one.join()
        print(*(module.name for module in user.modules()), flush=True)
"""


def test_a_child_of_a_module_connects_anew_and_its_parent_goes_on(tmp_path: Path) -> None:
    """ZeroMQ's threads are not forked: with its parent's context a child would wait for ever."""
    with central(tmp_path) as daemon, program(PARENT, daemon.address) as parent:
        said, errors = parent.communicate(timeout=60)
        assert said.splitlines() == ["child parent", "parent"], errors
