"""What is written while steps go on: in order, and nothing that fails is swallowed."""

import threading

import pytest
from mpi4py import MPI

from periporo.errors import OutputError
from periporo.io.output.background import BUSY, FAILED, Background


@pytest.fixture
def background():
    writing = Background(MPI.COMM_SELF)
    yield writing
    writing.close()


def full():
    raise OSError(28, "No space left on device")


def test_things_are_done_in_their_order_while_the_giver_goes_on(background):
    gate, done = threading.Event(), []
    background.do("cannot wait", gate.wait)
    for number in range(5):
        background.do("cannot note", done.append, number)
    background.afterwards("cannot note", done.append, "last")
    assert background.signs() == BUSY and done == []
    gate.set()
    background.settle()
    assert done == [*range(5), "last"] and background.signs() == 0


def test_a_failure_is_raised_once_looked_at_and_what_follows_it_is_dropped(background):
    done, undone = [], []
    background.undo = lambda: undone.append(True)
    background.do("cannot write run.vtkhdf", full)
    background.do("cannot write run.vtkhdf", done.append, 1)
    while background.signs() & BUSY:
        pass
    assert background.signs() == FAILED
    background.look(BUSY)  # this rank's signs are among those of all, so they say FAILED
    with pytest.raises(OutputError, match="^cannot write run.vtkhdf: No space left on device$"):
        background.look(FAILED)
    assert done == [] and undone == [True]


def test_a_fault_of_the_program_keeps_its_traceback(background):
    background.do("cannot write", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        background.settle()


def test_who_gives_more_than_there_is_room_for_waits(background, monkeypatch):
    monkeypatch.setattr("periporo.io.output.background._MOST_BYTES", 10)
    gate, given = threading.Event(), []

    def give():
        for number in range(4):
            background.do("cannot wait", gate.wait, size=4)
            given.append(number)

    giver = threading.Thread(target=give)
    giver.start()
    giver.join(0.2)
    assert len(given) == 2 and giver.is_alive()
    gate.set()
    giver.join(10.0)
    background.settle()
    assert len(given) == 4
