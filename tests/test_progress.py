from maglev_offline.progress import SILENT


def test_the_silent_listener_hears_everything_and_says_nothing(capsys):
    SILENT.say("a fact")
    SILENT.warn("a warning")
    with SILENT.task("training", 10, "steps") as tick:
        tick(10)
    assert capsys.readouterr() == ("", "")
