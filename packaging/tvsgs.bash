# Completion of tvsgs and tvsgs-* for bash. The commands themselves say what may follow (--help-words).
_tvsgs() {
    local program=$1 word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD - 1]}
    local -a path=("${COMP_WORDS[@]:1:COMP_CWORD-1}")
    COMPREPLY=()
    if [[ ${program##*/} == tvsgs ]] && ((COMP_CWORD > 1)); then
        if [[ ${path[0]} == help ]]; then
            path=()
        else
            program+=-${path[0]}
            path=("${path[@]:1}")
        fi
    fi
    command -v "$program" >/dev/null || return
    local lines names
    lines=$("$program" "${path[@]}" --help-words 2>/dev/null) || return
    if [[ $before == --set && $lines == *--list-keys* ]]; then
        names=$("$program" --list-keys 2>/dev/null | sed -n 's/^  \([a-z0-9_.]*\) .*/\1=/p')
        mapfile -t COMPREPLY < <(compgen -W "$names" -- "$word")
        compopt -o nospace 2>/dev/null
        return
    fi
    local value
    value=$(grep -m1 -F -- "$before"$'\t' <<<"$lines")
    if [[ $before == --* && -n $value ]]; then
        value=${value#*$'\t'}
        if [[ -n $value ]]; then
            mapfile -t COMPREPLY < <(compgen -W "$value" -- "$word")
        else
            mapfile -t COMPREPLY < <(compgen -f -- "$word")
            compopt -o filenames 2>/dev/null
        fi
        return
    fi
    names=$(cut -f1 <<<"$lines")
    [[ $word == -* ]] || names=$(grep -v '^-' <<<"$names")
    mapfile -t COMPREPLY < <(compgen -W "$names" -- "$word")
    [[ -n ${COMPREPLY[*]} || $word == -* ]] && return
    mapfile -t COMPREPLY < <(compgen -f -- "$word")
    compopt -o filenames 2>/dev/null
}
mapfile -t _tvsgs_commands < <(compgen -c tvsgs- | sort -u)
complete -F _tvsgs tvsgs "${_tvsgs_commands[@]}"
unset _tvsgs_commands
