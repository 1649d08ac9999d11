# bash complete.bash SCRIPT WORD...: what bash offers for the last word, one on each line
source "$1"
shift
COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMP_LINE="$*" COMP_POINT=${#COMP_LINE} COMPREPLY=()
complete -p tailstack >/dev/null || exit
function=$(complete -p tailstack | sed 's/.*-F \([^ ]*\).*/\1/')
"$function" tailstack "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\n' "${COMPREPLY[@]}"
