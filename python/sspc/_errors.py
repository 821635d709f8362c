"""What goes wrong, in the programs' words."""


class Error(Exception):
    """Why sspc did not do what was asked: one line of what went wrong and one of advice.

    `code` is the programs' exit code: 2 the arguments make no sense, 3 an input is not what it should be, 4 the run
    failed.
    """

    def __init__(self, message: str, advice: str = "", code: int = 4) -> None:
        super().__init__(message, advice, code)
        self.message = message
        self.advice = advice
        self.code = code

    def __str__(self) -> str:
        return f"{self.message}\nadvice: {self.advice}" if self.advice else self.message


class FrameWarning(UserWarning):
    """What a person should know of a frame: absent features, halves whose noise is not independent, ..."""
