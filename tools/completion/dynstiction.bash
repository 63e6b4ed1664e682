# Completion of dynstiction's command line for bash. The program itself says what there is.

_dynstiction() {
  local line=${COMP_LINE:0:COMP_POINT} word candidate ending file
  local -a words
  read -ra words <<< "$line"
  [[ $line != *[[:blank:]] ]] || words+=('')
  word=${words[-1]}
  COMPREPLY=()
  while read -r candidate; do
    if [[ $candidate == '*/' ]]; then
      while read -r file; do
        COMPREPLY+=("$file")
      done < <(compgen -d -- "$word")
      compopt -o filenames 2> /dev/null
    elif [[ $candidate == '*.'* ]]; then
      ending=${candidate#\*.}
      while read -r file; do
        [[ $file != *."$ending" && ! -d $file ]] || COMPREPLY+=("$file")
      done < <(compgen -f -- "$word")
      compopt -o filenames 2> /dev/null
    else
      # bash takes what stands before a '=' for a word of its own.
      [[ $word != *=* || $COMP_WORDBREAKS != *=* ]] || candidate=${candidate#"${word%=*}="}
      COMPREPLY+=("$candidate")
      [[ $candidate != *= ]] || compopt -o nospace 2> /dev/null
    fi
  done < <("${words[0]/#\~/$HOME}" complete "${words[@]:1}" 2> /dev/null)
}

complete -F _dynstiction dynstiction
