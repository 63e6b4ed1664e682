# Completion of dynstiction's command line for fish. The program itself says what there is.

function __dynstiction_complete
    set -l typed (commandline -ct)
    set -l words (commandline -opc) "$typed"
    for candidate in ($words[1] complete $words[2..-1] 2> /dev/null)
        if test "$candidate" = '*/'
            for folder in $typed*/
                echo $folder
            end
        else if string match -q '\**' -- $candidate
            set -l ending (string sub -s 2 -- $candidate)
            for file in $typed*$ending $typed*/
                echo $file
            end
        else
            echo $candidate
        end
    end
end

complete -c dynstiction -f -a '(__dynstiction_complete)'
