# zsh -f complete.zsh FOLDER LINE: what zsh offers at the end of a line, one on each line; FOLDER holds _tailstack.
# A shell of its own on a terminal of its own, in which compadd says what it is given.
zmodload zsh/zpty
cat > $1/init <<'INIT'
PROMPT=''
fpath+=($FOLDER)
autoload -Uz compinit
compinit -D -u
bindkey '^I' complete-word
compadd () {
  if [[ ${@[1,(i)(-|--)]} == *-(O|A|D)\ * ]]; then builtin compadd "$@"; return $?; fi
  typeset -a hits
  builtin compadd -A hits "$@"
  [[ -n $hits ]] || return 1
  builtin compadd "$@"
  for hit in $hits; do print -r -- "HIT $hit"; done
}
leave () { print -r -- ENDED; exit }
comppostfuncs=(leave)
INIT
FOLDER=$1 zpty shell zsh -f -i
zpty -w shell "FOLDER=$1; source $1/init; print -r -- RE''ADY"
while zpty -r shell line; do [[ $line == *READY* ]] && break; done
zpty -w -n shell "$2"$'\t'
while zpty -r shell line; do [[ $line == *ENDED* ]] && break; print -r -- "$line"; done |
  tr -d '\r' | grep -o 'HIT .*' | sed 's/HIT //' | sort -u
