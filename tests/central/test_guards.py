"""A failing task knows the nearest exception handlers above it: they are those that a search up to the root finds."""

from central.player import IN_PYTHON
from hypothesis import given, settings
from hypothesis import strategies as st

from tca_central.model.guards import MOST_IDLE, Guard, Guards

pytestmark = IN_PYTHON


class Kind:
    """A message: whether exception handlers are attached to it."""

    def __init__(self) -> None:
        self.attached = 0


class Node:
    """A task, as far as guards go."""

    def __init__(self, parent: "Node | None", kind: Kind) -> None:
        self.parent, self.kind, self.attached = parent, kind, 0
        self.children: dict[int, Node] = {}
        self.guard: Guard | None = None
        self.looks = 0

    @property
    def has_exception_handlers(self) -> bool:
        self.looks += 1
        return bool(self.attached or self.kind.attached)

    def searched(self) -> "list[Node]":
        found, at = [], self
        while at is not None:
            found += [at] if at.has_exception_handlers else []
            at = at.parent  # type: ignore[assignment]
        return found


class World:
    """A tree that grows and shrinks, and what is attached to its tasks and messages."""

    def __init__(self) -> None:
        self.kinds = [Kind() for _ in range(3)]
        self.root = Node(None, Kind())
        self.guards = Guards(self.root)
        self.nodes = [self.root]

    def add(self, parent: Node, kind: Kind) -> Node:
        node = Node(parent, kind)
        parent.children[id(node)] = node
        self.nodes.append(node)
        self.guards.add(node)
        return node

    def end(self, node: Node) -> None:
        if node.parent is not None and not node.children:
            del node.parent.children[id(node)]
            self.nodes.remove(node)
            node.guard = None

    def attach(self, node: Node) -> None:
        node.attached += 1
        self.guards.attached_to(node)

    def attach_to_all(self, kind: Kind) -> None:
        kind.attached += 1
        if kind.attached == 1 and len(self.nodes) > 1:
            self.guards.begin_age()


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 99), st.integers(0, 2)), max_size=80))
@settings(max_examples=60)
def test_they_are_those_that_a_search_finds(steps: list[tuple[int, int, int]]) -> None:
    world = World()
    for what, where, which in steps:
        node, kind = world.nodes[-1 - where % len(world.nodes)], world.kinds[which]
        if what <= 1:
            world.add(node, kind)
        elif what == 2:
            world.end(node)
        elif what == 3:
            world.attach(node)
        elif what == 4:
            node.attached = max(0, node.attached - 1)
        elif what == 5:
            world.attach_to_all(kind)
        else:
            kind.attached = max(0, kind.attached - 1)
        assert list(world.guards.above(node)) == node.searched()


def deep(size: int) -> tuple[World, Node]:
    world = World()
    node = world.root
    for _ in range(size):
        node = world.add(node, world.kinds[0])
    return world, node


def cost(world: World, node: Node) -> int:
    before = sum(one.looks for one in world.nodes)
    assert list(world.guards.above(node)) is not None
    return sum(one.looks for one in world.nodes) - before


def test_what_comes_and_goes_far_above_makes_no_search_long() -> None:
    world, bottom = deep(500)
    top = world.nodes[1]
    costs = []
    for _ in range(20):
        world.attach(top)
        costs.append(cost(world, bottom))
        top.attached = 0
        costs.append(cost(world, bottom))
    assert costs[0] > 400  # the first time it is looked for, once
    assert max(costs[1:]) < 10


def test_many_that_have_lost_theirs_are_passed_over_once() -> None:
    world = World()
    node = world.root
    for _ in range(10 * MOST_IDLE):
        node = world.add(node, world.kinds[0])
        world.attach(node)
    for one in world.nodes:
        one.attached = 0
    assert cost(world, node) > 9 * MOST_IDLE
    assert cost(world, node) <= MOST_IDLE + 2
