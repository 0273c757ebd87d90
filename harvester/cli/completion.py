"""`harvester completion`: shell completion of commands, options, scenes and files."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from harvester.base.arguments import check_name
from harvester.base.signatures import Kind

# In a file, zsh's script is a function to be called; if evaluated, the script must be registered.
ZSH_EVALUATED = """\
if [[ $zsh_eval_context[-1] == eval ]]; then
  compdef _cyclopts_harvester harvester
else
  _cyclopts_harvester "$@"
fi"""
Shell = Literal["bash", "zsh", "fish"]


def completion(shell: Annotated[Shell, Kind("SHELL")], /) -> None:
    """Print the completion script of a shell.

    For one session, evaluate the script with eval. To install it, write it into the shell's folder,
    such as ~/.local/share/bash-completion/completions/harvester.

    Parameters
    ----------
    shell : str
        bash, zsh, fish.

    Examples
    --------
    ::

        harvester completion bash
    """
    from harvester.cli.table import COMMANDS, app_of
    from harvester.scene.source import built_in_names

    check_name("shell", shell, get_args(Shell))
    print(app_of(COMMANDS, scenes=built_in_names()).generate_completion(shell=shell))
    if shell == "zsh":
        print(ZSH_EVALUATED)
